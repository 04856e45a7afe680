"""Light maps in numbers: charts of a scene's surfaces, their packing, the points behind texels, and
noise removal. Numpy only.
"""
