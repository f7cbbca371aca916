"""What a stream of MAVLink frames says of its vehicles."""
