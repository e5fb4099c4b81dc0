"""Machines with effects that the declared model of their plant lacks; like all generators they share no code with the estimator.

`effects.py` has the laws, `acting.py` the faults between command and force, `sensing.py` those of sensors, `motions.py` the excitations,
`rig.py` the closed loop; then one file for every plant.
"""
