from .build import (
    build_effects as build_effects,
)
from .check import (
    check_effect as check_effect,
)
from .facts import (
    Array as Array,
    Branch as Branch,
    Conditions as Conditions,
    Context as Context,
    Indices as Indices,
    Poses as Poses,
    RobotFacts as RobotFacts,
)
from .kinds import (
    At as At,
    Effect as Effect,
    Geometry as Geometry,
    Load as Load,
    Loop as Loop,
    ParallelSpring as ParallelSpring,
    Sensor as Sensor,
    Spring as Spring,
    SpringLaw as SpringLaw,
)
from .language import (
    AXES as AXES,
    Language as Language,
    Move as Move,
    Programme as Programme,
    axis_names as axis_names,
    check_language as check_language,
    languages as languages,
    maker_of as maker_of,
    parse_source as parse_source,
    programme_files as programme_files,
    read_source as read_source,
)
from .parameter import (
    Parameter as Parameter,
)
from .poses import (
    Orientation as Orientation,
    matrix as matrix,
    quaternion_pose as quaternion_pose,
)
from .problems import (
    InputError as InputError,
    Problem as Problem,
    nearest as nearest,
    refuse as refuse,
    some_of as some_of,
)
from .reader import (
    MeasuredFile as MeasuredFile,
    PointTable as PointTable,
    Reader as Reader,
    check_reader as check_reader,
    read_points as read_points,
)
from .registry import (
    find as find,
    registry as registry,
)
from .rotations import (
    cos_sin as cos_sin,
    cross_matrix as cross_matrix,
    exponential as exponential,
    turns as turns,
)
from .settings import (
    place as place,
    setting as setting,
)
from .shapes import (
    FINE as FINE,
    KNOTS as KNOTS,
    bent as bent,
    by_attitude as by_attitude,
    by_coming as by_coming,
    by_torque as by_torque,
    circular as circular,
    magnitude as magnitude,
    smooth as smooth,
)
from .source import (
    AMBIGUOUS as AMBIGUOUS,
    NUMBER as NUMBER,
    Cell as Cell,
    Parts as Parts,
    ProgrammeMotion as ProgrammeMotion,
    ProgrammePoint as ProgrammePoint,
    Source as Source,
    SourceStatement as SourceStatement,
    Token as Token,
    bracketed as bracketed,
    called as called,
    enclosed as enclosed,
    left_of as left_of,
    number as number,
    numbers as numbers,
    shown as shown,
    split as split,
    statements as statements,
    tokenise as tokenise,
    unmoved as unmoved,
    variable as variable,
)
from .terms import (
    Actuator as Actuator,
    Bar as Bar,
    Coordinate as Coordinate,
    GeometryTerm as GeometryTerm,
    LawTerm as LawTerm,
    Loads as Loads,
    LoadTerm as LoadTerm,
    LoopTerm as LoopTerm,
    Point as Point,
    Range as Range,
    Reading as Reading,
    SensorTerm as SensorTerm,
    StiffnessTerm as StiffnessTerm,
    TensionTerm as TensionTerm,
    TorqueTerm as TorqueTerm,
    VirtualJoint as VirtualJoint,
)
