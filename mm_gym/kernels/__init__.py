"""The compiled kernels. They never raise; they return a status code.

Everything that changes while an episode runs lives in the columns of one array (`layout`), one
column a lane, so a single environment, a simulation and a vector of a million environments run the
same code and agree to the last bit.
"""
