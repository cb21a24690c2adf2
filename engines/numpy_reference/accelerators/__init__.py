"""How the closest hit is found: one primitive after the other, or through a tree of boxes."""
