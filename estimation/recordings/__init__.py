"""What was recorded: files, columns, units and samples, checked where they enter.

recording.py                      the samples of one run
table.py, culprit.py, units.py    files of any kind as columns in SI units
samples.py, excitation.py         what a sound recording is
delay.py, noise.py                a sensor's lag taken out; its noise from the samples alone
"""
