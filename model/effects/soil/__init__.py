"""What the soil does beside Eq. 1-10."""
