"""Plan the flights for a wanted accuracy, predicted by the Cramér-Rao bound."""
