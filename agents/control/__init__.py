"""What a control loop is made of: a controller, what it observes and knows, and its actuators."""
