"""How results, logs and plans show themselves: on one screen, in a notebook, as a frame."""
