//! What a change of a key means for a run that is resumed.

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    const OFFLINE: &str = "[dataset]\npath = \"x.hdf5\"\n[collect]\n";

    fn config(text: &str, sets: &[(&str, &str)]) -> Config {
        let sets: Vec<(String, String)> = sets
            .iter()
            .map(|(key, value)| ((*key).to_owned(), (*value).to_owned()))
            .collect();
        Config::parse(text, "x.toml", "x", &sets).unwrap()
    }

    #[test]
    fn every_key_is_in_the_table_once_and_none_besides() {
        let [offline, walker] =
            [OFFLINE, "[run]\nkind = \"walker\"\n"].map(|text| config(text, &[]));
        let mut read: BTreeSet<String> = flat(offline.resolved()).into_keys().collect();
        read.extend(flat(walker.resolved()).into_keys());
        let listed: Vec<String> = TABLES
            .iter()
            .flat_map(|(table, keys)| keys.iter().map(move |(key, _)| format!("{table}.{key}")))
            .collect();
        let unique: BTreeSet<String> = listed.iter().cloned().collect();
        assert_eq!(
            unique.len(),
            listed.len(),
            "a key stands twice in the table"
        );
        assert_eq!(read, unique);
    }

    #[test]
    fn changes_are_told_with_what_becomes_of_them() {
        let made = config(OFFLINE, &[]);
        assert_eq!(made.changes(&made), []);
        let now = config(
            OFFLINE,
            &[
                ("topology.actors", "3"),
                ("graph.nodes", "100"),
                ("evaluation.episodes", "7"),
                ("rollouts.seconds", "1"),
            ],
        );
        let told: Vec<(String, OnResume)> = now
            .changes(&made)
            .into_iter()
            .map(|change| (change.to_string(), change.on_resume))
            .collect();
        let expected = [
            ("evaluation.episodes: 100 -> 7", Episodes),
            ("graph.max_nodes: 300 -> 150", Fixed),
            ("graph.nodes: 200 -> 100", Fixed),
            ("rollouts.seconds: 15.0 -> 1.0", Rollouts),
            ("topology.actors: 2 -> 3", Free),
        ];
        let expected = expected.map(|(change, on_resume)| (change.to_owned(), on_resume));
        assert_eq!(told, expected);
    }

    #[test]
    fn what_is_played_is_fixed_in_a_deterministic_run() {
        let fixed = [("run.deterministic", "true")];
        let made = config(OFFLINE, &fixed);
        for (key, value) in [("rollouts.rounds", "9"), ("execution.look_ahead", "3")] {
            let now = config(OFFLINE, &[fixed[0], (key, value)]);
            assert_eq!(now.changes(&made)[0].on_resume, Fixed, "{key}");
        }
    }
}
