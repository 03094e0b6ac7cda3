"""Reports of a finding: text, plots and HTML."""
