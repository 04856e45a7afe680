"""Reports, charts, previews and recordings: results as dictionaries, tables, CSV and images."""
