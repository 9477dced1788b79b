"""The monitor of a drive whose controller is unknown: driven by the measured current (M40 to M46).

From the current it predicts speed and position; it needs neither gains nor the command's course.
"""
