"""Objects on horizontal surfaces, and free places where an object can be put down."""
