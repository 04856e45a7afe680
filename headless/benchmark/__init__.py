"""The benchmark: measurements, and the tables, findings, charts and reports made from them."""
