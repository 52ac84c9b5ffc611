"""The compiled part: the equation of a flight, contact with the bed and with other grains, and how a scene is prepared for it."""
