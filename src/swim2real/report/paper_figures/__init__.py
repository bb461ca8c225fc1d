"""Figures for papers: vector and pixels, without LaTeX, the same look for a method in all of them."""

from swim2real.report.paper_figures.writing import FIGURES, write_figures

__all__ = ["FIGURES", "write_figures"]
