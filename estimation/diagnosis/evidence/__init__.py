"""How probable recordings make a model: what two of them compare by, and what is supposed of residual forces meanwhile."""
