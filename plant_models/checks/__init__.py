"""What every plant promises, as short manoeuvres: `check_plant` runs them all, `quick_check` the few before a drive."""
