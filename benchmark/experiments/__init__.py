"""Experiments: methods run on sequences, and the tables, findings, charts and reports made from
what they measured.
"""
