"""The surface map: horizontal surfaces, merged over the views of the whole trajectory."""
