"""What the wheel force transducer gets wrong."""
