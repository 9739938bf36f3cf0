"""What SLAM back ends share; the back ends themselves are the folders here, named in :mod:`.backends`."""
