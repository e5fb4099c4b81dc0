"""What every candidate would gain, from one factorisation of the smoothed model, without a fit.

supermodel.py, enlarged.py    the model with all of them in it, without effect
score.py, screen.py           their scores; all of them, with chances (chance.py) and what is alike
onsets.py                     since when
shares.py, lasting.py         how large an effect is beside the forces at its place, and how much of a force lasts
separation.py                 what would tell two of them apart
"""
