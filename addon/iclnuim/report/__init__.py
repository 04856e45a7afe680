"""Reports, charts and previews: results as dictionaries, tables, CSV and pictures."""
