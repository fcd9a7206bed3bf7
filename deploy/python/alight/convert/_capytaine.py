"""Datasets of Capytaine (https://capytaine.org) as the response table that `--hull` reads.

Both have axes forward, port, up; motion Re(H a exp(-i omega t)); directions towards which the waves travel. Capytaine gives the
motion of the rotation centre, the table that of the mesh's origin in the still-water plane.
"""

from .._lazy import h5netcdf, netcdf4, pandas, xarray
from .._lazy import numpy as np
from .._program import AlightError
from ._frame import Converted

DOFS = ("Surge", "Sway", "Heave", "Roll", "Pitch", "Yaw")
HEAVE, ROLL, PITCH = 2, 3, 4
DOF_AXES = ("influenced_dof", "radiating_dof")
MATRICES = ("added_mass", "radiation_damping", "inertia_matrix", "hydrostatic_stiffness")
# Limits of the program's reader (tests/src/physics/vessel/response/table.rs): rad/s; m/m and rad/m.
MAX_OMEGA, MAX_RESPONSE = 100.0, 20.0
# Added roll damping, fraction of critical. Potential flow has no viscosity; the supplied hulls have 0.06 to 0.12.
ROLL_DAMPING = 0.08
GRAVITY = 9.81


class Response(Converted):
    """Response table with a row for each frequency and direction."""

    def summary(self) -> str:
        """Description of the table: number of rows and range of frequencies."""
        omega = self.table["omega_radps"]
        return f"{self.format}, {len(omega)} rows from {omega.min():g} to {omega.max():g} rad/s"

    def write(self, _path: str, out: str) -> None:
        """Writes the CSV."""
        self.table.to_csv(out, index=False, float_format="%.6g")
        self.out = out


def read(path: str, _system) -> Response:
    """Reads a dataset. Its RAO is used if present, otherwise solved from the matrices."""
    if not h5netcdf.is_there():
        netcdf4.Dataset  # Its error names what to install.
    try:
        return _response(path, _sorted(path, xarray.load_dataset(path)))
    except (KeyError, ValueError) as error:
        raise AlightError(f"{path}: no dataset of Capytaine that can be converted: {error}", 2) from None


def _response(path: str, dataset) -> Response:
    response = Response("dataset of Capytaine")
    omega, radians = (dataset[axis].values for axis in ("omega", "wave_direction"))
    if "RAO" in dataset:
        dof = "influenced_dof" if "influenced_dof" in dataset["RAO"].dims else "radiating_dof"
        motion = dataset["RAO"].transpose("omega", "wave_direction", dof).values.copy()
    else:
        motion = _solved(path, dataset)
        response.notes.append(f"roll damping of {ROLL_DAMPING} of critical is added; an RAO in the dataset is taken as it is")
    if "rotation_center" in dataset.coords and dataset["rotation_center"].size == 3:
        motion[..., :3] += np.cross(dataset["rotation_center"].values.reshape(3), motion[..., 3:])
    else:
        response.notes.append("without rotation_center, the mesh's origin is taken for it")
    # The program mirrors directions to the other side.
    degrees, kept = np.unique(np.round(np.degrees(radians), 3) % 360.0, return_index=True)
    degrees, motion = degrees[degrees <= 180.0], motion[:, kept[degrees <= 180.0]]
    if np.max(np.abs(radians)) > 6.3 or len(degrees) < 3 or (degrees[0], degrees[-1]) != (0.0, 180.0):
        raise AlightError(f"{path}: wave_direction has {radians} rad; needed are three or more from 0 to pi, as np.linspace(0, pi, 13)", 2)
    for k, j, d in np.argwhere(~(np.abs(motion) <= MAX_RESPONSE)):
        at = f"{DOFS[d]} at {omega[k]:g} rad/s and {degrees[j]:g} deg"
        raise AlightError(f"{path}: {at} is {abs(motion[k, j, d]):g} per m of wave, allowed is {MAX_RESPONSE:g}; check mass and center_of_mass", 2)
    beam, slope = np.argmin(np.abs(degrees - 90.0)), omega[0] ** 2 / GRAVITY
    pitch, roll = abs(motion[0, 0, PITCH]) / slope, abs(motion[0, beam, ROLL]) / slope / np.sin(np.radians(degrees[beam]))
    response.notes.append(
        f"at {omega[0]:g} rad/s heave is {abs(motion[0, 0, HEAVE]):.2f} of the wave's amplitude, pitch {pitch:.2f} and roll {roll:.2f} of "
        "its slope; in long waves on deep water all three are 1, or inertia_matrix and hydrostatic_stiffness disagree"
    )
    columns = [f"{dof.lower()}_{part}" for dof in DOFS for part in ("re", "im")]
    parts = np.stack([motion.real, motion.imag], axis=-1).reshape(-1, len(columns))
    grid = [np.repeat(omega, len(degrees)), np.tile(degrees, len(omega))]
    response.table = pandas.DataFrame(np.column_stack([*grid, parts]), columns=["omega_radps", "direction_deg", *columns])
    return response


def _sorted(path: str, dataset):
    """Dataset at zero speed, with complex values, ascending frequencies and the six degrees of freedom in order."""
    for name, values in dataset.data_vars.items():
        if "complex" in values.dims:
            dataset[name] = values.sel(complex="re", drop=True) + 1j * values.sel(complex="im", drop=True)
    if "omega" in dataset.coords and "omega" not in dataset.sizes and dataset["omega"].ndim == 1:
        dataset = dataset.swap_dims({dataset["omega"].dims[0]: "omega"})
    if "forward_speed" in dataset.coords and np.any(dataset["forward_speed"].values != 0.0):
        raise AlightError(f"{path}: forward_speed is not 0; compute the hull at rest: the simulation adds the speed", 2)
    for dof in set(DOF_AXES).intersection(dataset.sizes):
        names = [str(name) for name in dataset[dof].values]
        if not set(DOFS) <= set(names):
            raise AlightError(f"{path}: {dof} has {', '.join(names)}; needed are {', '.join(DOFS)} (cpt.rigid_body_dofs)", 2)
        dataset = dataset.sel({dof: list(DOFS)})
    # The added mass may include its limits at frequency 0 and infinity, for which no waves exist.
    omega = dataset["omega"].values
    dataset = dataset.isel(omega=(omega > 0.0) & np.isfinite(omega)).sortby("omega")
    if dataset.sizes["omega"] < 2 or dataset["omega"][-1] > MAX_OMEGA:
        raise AlightError(f"{path}: omega has {omega} rad/s; needed are two or more above 0, at most {MAX_OMEGA:g}", 2)
    return dataset


def _solved(path: str, dataset):
    """Solution H of (C - omega^2 (M + A) - i omega B) H = F for each frequency and direction."""
    missing = [name for name in (*MATRICES, "excitation_force") if name not in dataset]
    if missing:
        hint = "assemble radiation and diffraction of a body with a center_of_mass by assemble_dataset(results, hydrostatics=True)"
        raise AlightError(f"{path}: neither RAO nor {', '.join(missing)}; {hint}", 2)
    added, damping = (dataset[name].transpose("omega", *DOF_AXES).values for name in MATRICES[:2])
    inertia, stiffness = (dataset[name].transpose(*DOF_AXES).values for name in MATRICES[2:])
    if not stiffness[ROLL, ROLL] > 0.0:
        raise AlightError(f"{path}: the hull capsizes: roll stiffness is {stiffness[ROLL, ROLL]:g} Nm/rad; check center_of_mass", 2)
    mass, damping = inertia + added, damping.copy()
    damping[:, ROLL, ROLL] += 2.0 * ROLL_DAMPING * np.sqrt(stiffness[ROLL, ROLL] * mass[:, ROLL, ROLL])
    omega = dataset["omega"].values[:, None, None]
    force = dataset["excitation_force"].transpose("omega", "influenced_dof", "wave_direction").values
    return np.linalg.solve(stiffness - omega**2 * mass - 1j * omega * damping, force).transpose(0, 2, 1)
