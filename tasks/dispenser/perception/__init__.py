"""What the dispenser task sees; import from the modules, some load heavy libraries.

`feeder`: which level is on top. `wings`: held, hung, votes. `branch_point`: the spur's tip in an image. `spurs`:
deployment poses from clouds.
"""
