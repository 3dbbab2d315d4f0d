"""What can this recording tell?  Effects are concealed in a recording of the user's own, and looked for blind.

``recording`` is what is known of it; ``trials`` draws what is concealed, and how large; ``inject`` puts it into the readings, so that
noise, hand and sensor stay as they were recorded; ``files`` writes the session folder; ``power`` counts from what size on each effect
is found; ``power_table`` prints; ``examine`` is all of it in order.
"""
