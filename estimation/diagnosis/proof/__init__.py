"""Before and after on what was held out.

proof.py                   windows of both models, compared in blocks (blocks.py)
predictor.py               a model on these recordings; windows.py, steps.py: many windows at once
contradicted.py            what goes out of the model again
ruling.py                  what that makes of the verdict
"""
