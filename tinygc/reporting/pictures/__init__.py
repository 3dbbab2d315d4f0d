"""What the pictures of an explanation and of a fit show: numbers, panels, and which panels of which effect."""
