"""Radar devices, a family: antenna positions and limits of chips on evaluation boards."""
