"""What every page is made of: template, style, charts, numbers in words, PDF."""
