"""A walk on hardware: links to robots, guard and log; numpy only, Python 3.8 on."""
