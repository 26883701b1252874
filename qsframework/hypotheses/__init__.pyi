from .catalogue.causes import Cause as Cause, Untested as Untested, find_causes as find_causes
