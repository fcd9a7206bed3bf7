"""Modules that are imported at their first use, so that functions that do not need them work without them."""

from __future__ import annotations

import importlib

WHY = {
    "numpy": "the series are its arrays",
    "mcap": "recordings and live data are read by it",
    "mcap_protobuf": "recordings and live data are read by it",
    "pandas": "tables are its frames",
    "matplotlib": "figures are drawn by it",
    "pymavlink": "logs of MAVLink and DataFlash are read by it",
    "pyulog": "ULog is read by it",
    "rosbags": "bags of ROS are read by it",
    "xarray": "datasets of Capytaine are read by it",
    "h5netcdf": "datasets of Capytaine are read by it",
    "netCDF4": "datasets of Capytaine are read by it and xarray",
}
PACKAGE = {"mcap_protobuf": "mcap-protobuf-support"}
# Packages of the wheel's extra `convert`.
EXTRA = ("pymavlink", "pyulog", "rosbags", "xarray", "netCDF4")


class Lazy:
    """Module that is imported at its first use; the error for a missing module names the package to install."""

    def __init__(self, name: str):
        self._name = name

    def __getattr__(self, attribute: str):
        return getattr(self._module(), attribute)

    def _module(self):
        package = self._name.split(".")[0]
        try:
            return importlib.import_module(self._name)
        except ImportError as error:
            if (error.name or "").split(".")[0] != package:
                raise
            named = PACKAGE.get(package, package)
            extra = " (or the wheel with its extra [convert])" if package in EXTRA else ""
            message = f"{WHY[package]}, and {named} is not installed: pip install {named}{extra}"
            raise ImportError(message, name=package) from None

    def is_there(self) -> bool:
        """Returns whether the module can be imported."""
        try:
            self._module()
        except ImportError:
            return False
        return True


numpy = Lazy("numpy")
pandas = Lazy("pandas")
mcap_reader = Lazy("mcap.reader")
mcap_records = Lazy("mcap.records")
mcap_decoder = Lazy("mcap_protobuf.decoder")
dfreader = Lazy("pymavlink.DFReader")
mavutil = Lazy("pymavlink.mavutil")
pyulog = Lazy("pyulog")
xarray = Lazy("xarray")
h5netcdf = Lazy("h5netcdf")
netcdf4 = Lazy("netCDF4")
rosbags_highlevel = Lazy("rosbags.highlevel")
rosbags_typesys = Lazy("rosbags.typesys")
