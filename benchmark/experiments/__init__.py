"""Experiments: methods run on sequences, and the tables, findings, charts and pages made from what
they measured.

recipes/{paper,stress,curve,system}   which cells, how they are measured, which tables and page
cell, code_version, inputs            a cell, and what identifies its code and its input
store, pool                           a file for each cell, and the processes that measure them
table, page, error_chart, shades      a table, the page of every experiment, charts, colours
outcome, stress_*, cells_file         what counts as failure and false success; results of stress
curves, fusion_curve, curve_chart     measurements of curves
paper_*, findings, correlation        measurements, tables and figures of the paper's experiments
odometry_chart                        the chart of `iclnuim bench odometry`
"""
