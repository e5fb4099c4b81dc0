"""Report pages: one self-contained HTML file per result, with the answer in words, tables and charts."""

from .diagnosis import write_diagnosis_report
from .page import write_report
from .simulation import write_simulation_report
from .tracking import write_tracking_report
from .weighing import balance_chart, parameter_chart, trade_off_chart, write_weighing_report
from .weight_grid import grid_chart

__all__ = [
    "balance_chart",
    "grid_chart",
    "parameter_chart",
    "trade_off_chart",
    "write_diagnosis_report",
    "write_report",
    "write_simulation_report",
    "write_tracking_report",
    "write_weighing_report",
]
