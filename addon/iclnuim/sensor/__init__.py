"""What a real camera adds to perfect images: depth and RGB noise. Arrays and a generator in, arrays out."""
