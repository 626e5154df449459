"""Do offsets help a flight?"""
