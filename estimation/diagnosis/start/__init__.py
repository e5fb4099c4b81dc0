"""Where a search begins: the model as it is, and the recordings as they are taken.

beginning.py                                   step by step
as_it_is.py                                    the smoothing that all is held against
misread.py, hold.py, delays.py                 columns, inputs and delays that may be other than the study says
dropouts.py, time_stamps.py                    signals that drop out, clocks that are off
noise_shown.py, sizes_known.py                 noise and sizes that are held since nothing could be compared without
"""
