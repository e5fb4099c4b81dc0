"""What was recorded: files, columns, units and samples, checked where they enter.

recording.py, columns.py          the samples of one run, and where a file has them
table.py, culprit.py, units.py    files of any kind as columns in SI units; mdf.py: those with many clocks
samples.py, excitation.py         what a sound recording is
delay.py, noise.py, outliers.py   a sensor's lag taken out; its noise and its gross outliers from the samples alone
drive.py                          inputs that change between the rows
gaps.py                           where a recording stops and goes on later
"""
