"""The library: what may be missing, at which place, as an edit of the model.

edits.py, candidate.py                  edits of a model; one of them, its strengths and shapes
places.py                               where a model can be edited
laws.py, loads.py, presliding.py        friction, springs, drag, waves of bodies and elements
frames.py, couplings.py, channels.py    bodies in a plane or in space; compliance and play; inputs and sensors
motors.py                               between a circuit and a shaft
memory.py                               what lags and delays hold when a recording begins
library.py                              all of them, and the parameters of the model; waves.py: periods too fine to try them all
"""
