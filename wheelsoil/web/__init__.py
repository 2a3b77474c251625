"""What the logger's page and the analyst's page share: who may ask, where they listen, how they are served."""
