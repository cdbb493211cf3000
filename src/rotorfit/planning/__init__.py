"""Which flights to fly for the accuracy wanted, predicted by the bound."""
