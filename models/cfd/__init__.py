"""Data from flow simulation: one ducted fan near ground and wall, steady RANS in an open solver."""
