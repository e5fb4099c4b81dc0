"""Moving horizons: a window of stages, its arrival cost and its Gauss-Newton steps."""
