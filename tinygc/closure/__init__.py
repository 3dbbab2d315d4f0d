"""The closure residual: integrated rate against the reference attitude; its noise floor and its linear solution."""
