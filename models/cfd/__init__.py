"""The CFD campaign of one ducted fan in the corner."""
