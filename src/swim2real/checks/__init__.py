"""Checks of what is given: do real trials fit a robot, how do they begin, and what does each parameter change?"""
