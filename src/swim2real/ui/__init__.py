"""The live page of `swim2real ui`: a folder of films, tracks, trials and runs, served to this machine alone.

All that the page does is done by the functions that the commands call, and is kept in the files that they write.
"""
