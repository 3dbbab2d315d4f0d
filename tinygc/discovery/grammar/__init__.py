"""What can be said: quantities, functions of them, products of two, patterns of axes; each form once, with its bits and its words."""
