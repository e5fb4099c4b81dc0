"""Whole-horizon smoothing, from recordings to estimates.

smoother.py, work.py            the whole way: what it starts from; meshes, weights and parameters in turn
horizons.py                     recordings as arrays in the model's order
approach.py                     from guesses far off to where a solve starts, from loose to tight balances
initial_guess.py, unseen.py     trajectories that follow the samples; what no output shows
along.py                        the model along a trajectory
meshing.py, mesh_error.py       how fine a mesh must be, and whether it was fine enough
program.py                      the program on a mesh
rest.py, law_velocity.py        friction near rest, and which velocity it is that rests
variances.py, marginal.py       weights that nobody gave; parameters with trajectories integrated out
robust.py, outliers.py          samples far off, and what was made of them
outcome.py, notes.py            what came out, in names and units and in words
prediction.py                   what was held out
profile.py                      how far a parameter may go before the data object
"""
