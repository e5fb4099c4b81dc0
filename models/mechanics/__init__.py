"""Mechanical components, by the way they move: translational, rotational, planar."""
