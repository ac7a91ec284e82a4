"""Result files read back as checked documents."""

from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas import FitDocument


def read_fit(path):
    return read_document(path, FitDocument)
