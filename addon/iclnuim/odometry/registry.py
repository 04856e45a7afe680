"""Odometers by name and preset."""

from __future__ import annotations

from ..errors import InputError
from ..geometry.camera import PinholeCamera
from . import dvo, icp, icp_rgbd, peers, rgbd
from .protocol import Odometer
from .reference import OWN, Reference

OURS = {
    "rgbd": (rgbd.Rgbd, rgbd.PRESETS),
    "dvo": (dvo.Dvo, dvo.PRESETS),
    "icp": (icp.Icp, icp.PRESETS),
    "icp_rgbd": (icp_rgbd.IcpRgbd, icp_rgbd.PRESETS),
}


def odometer(name: str, preset: str = "best") -> Odometer:
    """Raises InputError for an unknown name or preset, WorkError where a peer's package is missing."""
    if name in peers.NAMES:
        return (peers.OpencvPeer if "opencv" in name else peers.Open3dPeer)(name)
    if name not in OURS:
        raise InputError(f"an odometer ({', '.join((*OURS, *peers.NAMES))})", found=name)
    kind, presets = OURS[name]
    if preset not in presets:
        raise InputError(f"a preset of {name} ({', '.join(presets)})", found=preset)
    return kind(presets[preset])


def reference(name: str, odometer: Odometer, camera: PinholeCamera, preset: str = "best") -> Reference:
    """What to align against: `own` (what the odometer asks for), `frame`, `kept`, `entropy`, `model`; else an InputError."""
    if name in ("own", *OWN):
        return OWN[odometer.reference if name == "own" else name]()
    if name != "model":
        raise InputError("a reference (own, frame, kept, entropy, model)", found=name)
    from ..fusion.reference import ModelReference

    return ModelReference(odometer, camera, preset)
