"""Speed against accuracy: a setting of a method from fast to exact."""
