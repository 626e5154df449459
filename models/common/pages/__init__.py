"""Self-contained HTML pages: one style, and plots as SVG. They know nothing of what they show."""
