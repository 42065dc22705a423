"""The link between laptop and robot: routes, measured quality, ranking of transports, clock offset, DDS set-up."""
