"""Direct light at full frequency: triangle lights against the bins of a curve.

The environment becomes a hierarchy of spherical triangles, lamps become planar ones. For
every row and light: one shadow ray, and quotient · radiance · solid angle · cosine spread over
the few bins that the triangle overlaps (Ben-Artzi et al. 2006, section 5). A triangle that a
coordinate bends is split until it does not, and its pieces have rays and radiance of their own:
so the light of a large triangle stays sharp where narrow bins look at it.
"""
