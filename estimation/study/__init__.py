"""A study file and the problem that it poses.

schema.py         its tables and keys
study.py          TOML -> recordings, parameters, weights: a `Problem`
model_source.py   a plant by name, a Python function, a Modelica class
errors.py         what is wrong in it, and in which line
"""
