"""How slip changes the sinkage."""
