"""The surface map: views of horizontal surfaces, merged over the whole trajectory."""
