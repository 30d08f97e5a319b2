"""Pages and drawings: one HTML file that loads nothing, plots as SVG."""
