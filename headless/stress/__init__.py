"""Where methods fail: frames perturbed by known amounts, methods run on them, and what came of it. docs/stress.md has the definitions.

perturbations.toml   every perturbation with its five severities, as numbers; corruptions.toml is a second scale
plan                 such a file, read and checked; what a perturbation's name stands for
stretch              consecutive frames of a sequence, with whatever was changed about them
filters              changes of the images alone: noise, holes, brightness
motion               changes of when things are seen: blur, shutter, colour out of step, dropped frames
surfaces             things put into the scene: walls, panes, bars; corruptions are of the second scale
cell                 the figures of one method on one stretch
matrix               all cells, each a file, on all cores
summary              what came of them, over all stretches
pages                tables and heat maps
curves, fusion_curve speed against accuracy as one thing changes
"""
