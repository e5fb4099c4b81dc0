"""Round by round: the likely candidates fitted as full problems, and the best one kept, until nothing more is found.

search.py, round.py                                  the rounds; one of them
state.py, standing.py                                what was found so far, and what it is held against; the model with that
refit.py, fits.py, keep.py                           a candidate as a full problem; fits side by side, kept on disk
runaway.py                                           inertias that would answer for what is missing
late_signals.py                                      inputs and sensors that come late, where no score tells
choice.py, refusals.py, indistinct.py                what is worth a fit, what is borne out, what nobody could tell from it
amended.py, elimination.py, one_level.py             what is asked again of what was found, and goes out
findings.py                                          what is said of it
left_over.py, described.py                           what stays without a name
"""
