"""Light transport without paths: direct light by shadow rays, indirect light by radiosity.

A sparse set of surface points (surfels) around a view gets its direct light by emitter sampling and
exchanges diffuse light along rays between them (radiosity with exact visibility). Each pixel then
gathers this light once, along a few rays (final gathering, Jensen 1996).
"""
