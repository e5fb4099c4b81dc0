"""What a fit says about itself, and of how far its stated deviations can be believed.

innovations.py, chain.py            prediction errors of a smoothed record, which are white when the model is right
whiteness.py, autocorrelation.py    white? normal? how many independent values?
forces.py, patterns.py              are residual forces white, and what do they follow
together.py                         which of all these tests are doubted
criteria.py                         evidence, AIC, BIC
fit.py, validate.py                 all of it for every output and place
"""
