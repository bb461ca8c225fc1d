"""What the trials tell of the parameters around a run's best fit: identifiability, ensembles, what to record next."""
