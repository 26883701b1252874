from .importing import Imported as Imported, import_readings as import_readings
from .options import ImportFiles as ImportFiles, ImportOptions as ImportOptions
