"""What flies: the model of one fan, evaluated with numpy."""
