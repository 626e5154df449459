"""The pipeline of flight over a recorded log."""
