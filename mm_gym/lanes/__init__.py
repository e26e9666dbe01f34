"""Numbers side by side: vectors of lanes, their rows and memory, random numbers and functions.

Everything that changes while an episode runs lives in the columns of one array (`layout`), one
column a lane, so a single environment, a simulation and a vector of a million environments run the
same code and agree to the last bit. Kernels never raise; they return a status code.
"""
