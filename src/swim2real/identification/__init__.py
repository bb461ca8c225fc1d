"""Knowledge of the parameters around a run's best fit: identifiability, ensembles, what to record next."""
