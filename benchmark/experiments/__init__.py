"""Experiments: methods run on sequences, and the tables, findings, charts and pages made from what
they measured.

cell, code_version, inputs   a cell, and what identifies its code and its input
store, pool                  a file for each cell, and the processes that measure them
table, page                  a table, and the page of every experiment
outcome                      the errors of a method on some frames, and whether it reported them
experiment                   an experiment in one class
recipes/                     the experiments: paper, stress, curve, system
"""
