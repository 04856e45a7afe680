"""croissant.json of shards: a description of their files and records that hubs and mlcroissant read
(MLCommons, Croissant format specification 1.0).
"""

from collections.abc import Mapping
from typing import Any

from .metadata_lines import FILE as METADATA

_VERSION = "http://mlcommons.org/croissant/1.0"
#: The terms of the format, as its specification requires them in every file.
_CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
#: Fields of a frame in metadata.jsonl: their type and description.
_FIELDS = {
    "number": ("sc:Integer", "number of the frame"),
    "file_name": ("sc:Text", "name of the colour image"),
    "depth_file_name": ("sc:Text", "name of the depth image"),
    "stamp_s": ("sc:Float", "time stamp in seconds"),
    "width": ("sc:Integer", "pixels"),
    "height": ("sc:Integer", "pixels"),
    "fx": ("sc:Float", "focal length in pixels"),
    "fy": ("sc:Float", "focal length in pixels"),
    "cx": ("sc:Float", "principal point in pixels; 0 is the centre of the first pixel"),
    "cy": ("sc:Float", "principal point in pixels; 0 is the centre of the first pixel"),
    "depth_units_per_metre": ("sc:Float", "units of the depth image per metre; 0 is missing"),
    "T_world_camera": ("sc:Text", "4 x 4 matrix, metres, camera x right, y down, z forward"),
}
_IMAGES = {
    "rgb": "8-bit sRGB colour",
    "depth": "16-bit planar depth in units",
}


def croissant(
    about: Mapping[str, Any],
    digests: Mapping[str, str],
    sizes: Mapping[str, int],
    licence_url: str,
    citation: str,
) -> dict[str, Any]:
    """The content of croissant.json. about: name, frames; digests, sizes: SHA-256 and bytes of the
    shards and of metadata.jsonl, by file name.
    """
    files = []
    shards = []
    for file, digest in digests.items():
        kind = "application/jsonlines" if file == METADATA else "application/x-tar"
        if file != METADATA:
            shards.append({"@id": file})
        files.append(
            {
                "@type": "cr:FileObject",
                "@id": file,
                "name": file,
                "contentUrl": file,
                "contentSize": f"{sizes[file]} B",
                "encodingFormat": kind,
                "sha256": digest,
            }
        )
    sets = []
    records = [_frames()]
    for kind, text in _IMAGES.items():
        sets.append(
            {
                "@type": "cr:FileSet",
                "@id": f"{kind}-files",
                "name": f"{kind}-files",
                "containedIn": shards,
                "encodingFormat": "image/png",
                "includes": f"*.{kind}.png",
            }
        )
        records.append(_images(kind, text))
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": _VERSION,
        "name": about["name"],
        "description": f"An RGB-D sequence of {about['frames']} frames: colour, depth, camera, poses.",
        "license": licence_url,
        "citeAs": citation,
        "url": ".",
        "version": "1.0.0",
        "distribution": files + sets,
        "recordSet": records,
    }


def _frames() -> dict[str, Any]:
    """The records of metadata.jsonl."""
    fields = []
    for name, (kind, text) in _FIELDS.items():
        source = {"fileObject": {"@id": METADATA}, "extract": {"column": name}}
        fields.append(_field(f"frames/{name}", text, kind, source))
    return {
        "@type": "cr:RecordSet",
        "@id": "frames",
        "name": "frames",
        "description": "The frames in the order of time.",
        "key": {"@id": "frames/number"},
        "field": fields,
    }


def _images(kind: str, text: str) -> dict[str, Any]:
    """The records of the images of a kind: name and content."""
    files = {"fileSet": {"@id": f"{kind}-files"}}
    name = files | {"extract": {"fileProperty": "filename"}}
    content = files | {"extract": {"fileProperty": "content"}}
    return {
        "@type": "cr:RecordSet",
        "@id": f"{kind}_images",
        "name": f"{kind}_images",
        "description": f"{text}, named as in the frames.",
        "field": [
            _field(f"{kind}_images/file_name", "name of the image", "sc:Text", name),
            _field(f"{kind}_images/image", text, "sc:ImageObject", content),
        ],
    }


def _field(id: str, text: str, kind: str, source: dict[str, Any]) -> dict[str, Any]:
    return {
        "@type": "cr:Field",
        "@id": id,
        "name": id.partition("/")[2],
        "description": text,
        "dataType": kind,
        "source": source,
    }
