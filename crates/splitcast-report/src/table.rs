//! Tables.

/// A table: one header row, and any number of rows whose first cell names them.
///
/// Rows may be of any length: missing cells are empty, and cells beyond the header
/// stand in columns without a name.
#[derive(Clone, Debug, Default)]
pub struct Table {
    pub(crate) caption: String,
    columns: Vec<Column>,
    rows: Vec<Vec<Cell>>,
}

impl Table {
    /// A table without rows.
    pub fn new(columns: impl IntoIterator<Item = Column>) -> Self {
        Self {
            columns: columns.into_iter().collect(),
            ..Self::default()
        }
    }

    /// Adds a row. Text and numbers that are text already turn into plain cells.
    pub fn row<T: Into<Cell>>(mut self, cells: impl IntoIterator<Item = T>) -> Self {
        self.rows.push(cells.into_iter().map(Into::into).collect());
        self
    }

    /// The text above the table.
    pub fn caption(mut self, text: impl Into<String>) -> Self {
        self.caption = text.into();
        self
    }

    /// The header, as wide as the widest row.
    pub(crate) fn header(&self) -> Vec<Column> {
        let widest = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let missing = widest.saturating_sub(self.columns.len());
        let unnamed = std::iter::repeat_n(Column::left(""), missing);
        self.columns.iter().cloned().chain(unnamed).collect()
    }

    /// The rows, each as wide as the header.
    pub(crate) fn body(&self) -> Vec<Vec<Cell>> {
        let width = self.header().len();
        let mut rows = self.rows.clone();
        for row in &mut rows {
            row.resize(width, Cell::from(""));
        }
        rows
    }
}

/// A column's name, and the side on which its cells stand.
#[derive(Clone, Debug)]
pub struct Column {
    pub(crate) name: String,
    pub(crate) class: &'static str,
}

impl Column {
    /// A column of text.
    pub fn left(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            class: "",
        }
    }

    /// A column of numbers. Give them the same number of decimals.
    pub fn right(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            class: "right",
        }
    }

    /// A column of marks and short words.
    pub fn center(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            class: "center",
        }
    }
}

/// A cell: its text, and what it means.
#[derive(Clone, Debug)]
pub struct Cell {
    pub(crate) text: String,
    pub(crate) mark: Mark,
}

impl Cell {
    /// Marks a value that meets its goal, by colour and by a sign.
    pub fn good(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            mark: Mark::Good,
        }
    }

    /// Marks a value that falls short of its goal, by colour and by a sign.
    pub fn short(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            mark: Mark::Short,
        }
    }

    /// Lets a value stand out, such as the best of its column.
    pub fn strong(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            mark: Mark::Strong,
        }
    }

    /// Lets a value stand back.
    pub fn muted(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            mark: Mark::Muted,
        }
    }
}

impl<T: Into<String>> From<T> for Cell {
    fn from(text: T) -> Self {
        Self {
            text: text.into(),
            mark: Mark::None,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mark {
    None,
    Good,
    Short,
    Strong,
    Muted,
}

impl Mark {
    pub(crate) fn class(self) -> &'static str {
        match self {
            Mark::None => "",
            Mark::Good => "good",
            Mark::Short => "short",
            Mark::Strong => "strong",
            Mark::Muted => "muted",
        }
    }
}
