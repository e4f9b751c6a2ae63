"""Colours that frames, recordings and still pictures share."""

__all__ = ["TORQUE_STOPS"]

#: From -1 over 0 to 1: blue, white, orange, for everything that has a sign. Blue and orange stay
#: apart for every colour vision, and both ends are darker than the middle.
TORQUE_STOPS = ((8, 81, 156), (107, 174, 214), (250, 250, 250), (253, 174, 107), (217, 72, 1))
