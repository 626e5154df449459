"""The error of a model on flights that it was not made from."""
