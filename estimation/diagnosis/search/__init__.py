"""Round by round: the likely candidates fitted as full problems, and the best one kept, until nothing more is found.

search.py, round.py, standing.py                     the rounds; one of them; the model with what was found so far
refit.py, fits.py, keep.py                           a candidate as a full problem; fits side by side, kept on disk
inflated.py                                          inertias that would answer for what is missing
choice.py, refusals.py, indistinct.py                what is worth a fit, what is borne out, what nobody could tell from it
findings.py, elimination.py                          what is said of it; what goes out again
left_over.py, described.py                           what stays without a name
"""
