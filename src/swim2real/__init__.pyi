from swimbase.errors import Swim2RealError as Swim2RealError

from .api import Run as Run
from .api import compare as compare
from .api import evaluate as evaluate
from .api import open_run as open_run
from .api import simulate as simulate
from .calibration import Outcome as Outcome
from .comparison import ComparisonResults as ComparisonResults
from .demo import SyntheticCamera as SyntheticCamera
from .demo import synthetic_reference as synthetic_reference
from .objective import Comparison as Comparison
from .pipeline import calibrate as calibrate
from .pipeline import track_video as track_video
from .pipeline import track_videos as track_videos
from .pipeline.training import train as train
from .report import write_report as write_report
from .robots import load_robot as load_robot
from .robots.robot import Robot as Robot
from .settings import BriefingSettings as BriefingSettings
from .settings import CalibrationSettings as CalibrationSettings
from .settings import ComparisonSettings as ComparisonSettings
from .settings import EvaluationSettings as EvaluationSettings
from .settings import TrackingSettings as TrackingSettings
from .settings import TrainingSettings as TrainingSettings
from .settings import VlmAccess as VlmAccess
from .trials import MarkerTrack as MarkerTrack
from .trials import Trial as Trial
from .trials import TrialSet as TrialSet
from .trials import load_reference as load_reference
from .trials import save_reference as save_reference

__version__: str
