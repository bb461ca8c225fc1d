"""swim2real: marker tracks of a swimming robot in, a calibrated MuJoCo simulator out."""

__version__ = "0.1.0"
