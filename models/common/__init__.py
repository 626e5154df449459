"""What the three programs share: errors, files, arguments, progress, coordinate frames and pages."""
