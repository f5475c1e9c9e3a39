"""Seeing, for any task: pure functions; import from the modules, some load heavy libraries.

`markers`: corners and poses. `blobs`: one colour in an RGB-D image. `cloud`: depth images and point clouds. `sweep`:
clouds from a moving LiDAR.
"""
