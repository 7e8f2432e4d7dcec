"""Models of sensors: camera, light section (camera and laser plane), profile sensor.

`camera` and `distortion` relate pixels to rays, `light_section` a laser line to a profile in mm,
`rig_file` stores a light section, and `profile_sensor` is the noise model of commercial sensors.
"""
