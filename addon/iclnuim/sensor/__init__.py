"""Sensor models: depth noise, RGB noise and shutter of a real camera.

Functions take arrays and a random generator, and return arrays.
"""
