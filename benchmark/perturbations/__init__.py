"""Perturbations of frames by known amounts. docs/guide/stress.md has the definitions.

perturbations.toml   every perturbation with its five severities, as numbers
registry             the functions by name
plan                 reads and checks the file, and applies a perturbation
segment              consecutive frames of a sequence, with their perturbations
filters              perturbations of the images: noise, holes, brightness, blur
motion               perturbations of time: blur, rolling shutter, delayed colour, dropped frames
surfaces             objects put into the scene: walls, panes, bars
lighting             perturbations of light, air and lens: smoke, flicker, shadows, dots, dirt
ranging              perturbations by the principle of the depth sensor: a second projector, wrapped
                     phase, few zones
people               people who walk around the camera
"""
