"""The fluid: outlines, panels, added mass and its models."""
