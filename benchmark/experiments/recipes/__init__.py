"""The experiments: each recipe says which cells, how they are measured, and which page and tables
show them.
"""
