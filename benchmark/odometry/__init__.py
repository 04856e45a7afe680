"""RGB-D visual odometry: the built-in odometers, and adapters to third-party ones, behind one
protocol.
"""
