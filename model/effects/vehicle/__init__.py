"""What the vehicle, its wheel and its speeds do."""
