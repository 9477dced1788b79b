"""What all nodes share: lifecycle, parameters, status and their main."""
