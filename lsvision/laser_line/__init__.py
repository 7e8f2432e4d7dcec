"""Extraction of a laser line from a camera image to a fraction of a pixel.

In the order of the data flow: `line_image` reduces the image to the laser's channel (of a raw
colour image: to the laser's pixels), `candidates` finds ridges in each column, `path_search`
connects them to a line, `detection` decides whether it is a laser line, `subpixel` and
`gaussian_fit` locate it in windows around it (`stripe_windows`), `noise` and, in JPEG images,
`jpeg_blocks` estimate its standard deviation. `coarse_colours` chooses between colour and
luminance. `extraction` calls them all. `line_blur`, with `line_shape` and `line_spread`, corrects
an extracted line for the blur of the lens.
"""
